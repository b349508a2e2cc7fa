"""A parser of HTML pages for the tests of reports."""

from html.parser import HTMLParser

VOID = {"meta", "img", "br", "link"}


class Page(HTMLParser):
    """A parsed page; asserts that every element is closed where it should be."""

    def __init__(self, text):
        super().__init__()
        self.text = text
        self.open, self.seen, self.tables, self.images, self.items = [], [], [], [], []
        self.words = {}
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        assert len(given) == len(attributes), f"an attribute of {tag} stands twice"
        self.seen.append((tag, given))
        if tag == "img":
            self.images.append(given)
        if tag == "table":
            self.tables.append([])
        if tag == "tr":
            self.tables[-1].append([])
        if tag in ("td", "th"):
            self.tables[-1][-1].append("")
        if tag not in VOID:
            self.open.append(tag)
            self.words.setdefault(tag, []).append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        for tag in self.open:
            self.words[tag][-1] += data
        if self.open and self.open[-1] in ("td", "th"):
            self.tables[-1][-1][-1] += data

    def table(self, beginning):
        """The rows of the table whose caption begins with a text."""
        place = [c.startswith(beginning) for c in self.words["caption"]].index(True)
        return self.tables[place]
