"""A reader of HTML pages that finds elements which are not closed in order."""

from html.parser import HTMLParser

VOID = {"meta", "img", "br"}


class Checked(HTMLParser):
    """Every element is closed in order; collects headings and addresses."""

    def __init__(self):
        super().__init__()
        self.open, self.addresses, self.headings = [], [], []

    def handle_starttag(self, tag, attrs):
        if tag not in VOID:
            self.open.append(tag)
        self.addresses += [v for k, v in attrs if k in ("src", "href")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, words):
        if self.open and self.open[-1] == "h2":
            self.headings.append(words)
