"""Reports as HTML pages: one file with its style and pictures, which needs no network."""
