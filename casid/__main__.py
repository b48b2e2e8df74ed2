"""`python -m casid`: the same as the command `casid`."""

from casid.cli.app import main

if __name__ == "__main__":
    main()
