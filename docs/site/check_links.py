"""Checks a built site: check_links.py FOLDER. Every link of its pages must lead to a file, and to an anchor, of the
site; what a page loads (scripts, styles, pictures, fonts) must come from the site, too."""
import pathlib
import re
import sys
from html.parser import HTMLParser
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.anchors, self.links, self.loaded = set(), [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.anchors.update(given[name] for name in ("id", "name") if given.get(name))
        if given.get("src"):
            self.loaded.append(given["src"])
        if given.get("href"):
            loads = tag == "link" and given.get("rel") in ("stylesheet", "icon", "shortcut icon", "preload", "preconnect")
            (self.loaded if loads else self.links).append(given["href"])


def main(folder):
    pages = {path.resolve(): Page(path.read_text("utf-8")) for path in folder.rglob("*.html")}
    faults = []
    for path, page in pages.items():
        if path.name == "404.html":  # its links begin at the root of a server
            continue
        for link in page.links + page.loaded:
            url = urlsplit(link)
            if url.scheme or url.netloc:
                if link in page.loaded and url.netloc:
                    faults.append(f"{path.relative_to(folder)}: loads {link} from the network")
                continue
            target = (path.parent / unquote(url.path)).resolve() if url.path else path
            if target.is_dir():
                target = target / "index.html"
            if not target.exists():
                faults.append(f"{path.relative_to(folder)}: {link} leads nowhere")
            elif url.fragment and target in pages and unquote(url.fragment) not in pages[target].anchors:
                faults.append(f"{path.relative_to(folder)}: {link} has no such anchor")
    for style in folder.rglob("*.css"):
        for url in re.findall(r"""(?:@import|url\()\s*["']?((?:https?:)?//[^"')\s]+)""", style.read_text("utf-8")):
            faults.append(f"{style.relative_to(folder)}: loads {url} from the network")
    if not pages:
        faults.append(f"{folder}: no pages")
    for fault in sorted(set(faults)):
        print(f"check_links: {fault}", file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1]).resolve()))
