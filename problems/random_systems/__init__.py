"""Small systems drawn by chance, which nothing in casid was adjusted to, and the contract that holds for each result.

`world.py` draws linear models, truths with one nonlinearity or a hidden feedback, and their records, in numpy.
`contract.py` checks what a diagnosis says of them.
"""
