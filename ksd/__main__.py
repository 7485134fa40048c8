"""`python -m ksd` is the command `ksd`."""

import sys

from ksd.cli import main

if __name__ == "__main__":
    sys.exit(main())
