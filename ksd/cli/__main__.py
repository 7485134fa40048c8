"""`python -m ksd.cli` is the command `ksd`, as `python -m ksd` is."""

import sys

from ksd.cli import main

if __name__ == "__main__":
    sys.exit(main())
