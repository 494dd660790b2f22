"""`python -m bscd`: the command where its own name is not on the path."""

from bscd.cli.app import main

if __name__ == "__main__":
    main()
