"""``python -m cltransfer``."""

from .cli.main import main

if __name__ == "__main__":
    main()
