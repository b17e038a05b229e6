"""`python -m rayfarm`: the same program as `rayfarm`."""

from rayfarm.cli import main

if __name__ == "__main__":
    main()
