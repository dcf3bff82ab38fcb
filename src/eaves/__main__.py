"""`python -m eaves`: the command line."""

from eaves.cli.app import main

if __name__ == "__main__":
    main()
