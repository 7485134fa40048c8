"""The version of ksd."""

__version__ = "0.1.0"
