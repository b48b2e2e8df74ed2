"""The search for causes: which are tried, what each must pass, what held-out records say, how probable each is."""
