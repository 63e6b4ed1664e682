"""A Sphinx extension: there is no line break after the minus of a number, nor between a number and its unit."""

import re

from docutils import nodes
from sphinx.application import Sphinx

NUMBER = re.compile(
    r"([−-]?\d[\d.,]*e[+-]?\d+(?:\s(?:m?m/s|[mkµ]?[sNgm]|k?Hz|N/m)\b)?"
    r"|[−-]?\d[\d.,]*\s(?:%|°|(?:m?m/s|[mkµ]?s|[mk]?N|[mµ]m|kg|k?Hz|N/m|deg|[kM]B)\b))"
)


def keep_together(_: Sphinx, tree: nodes.document, __: str) -> None:
    for text in list(tree.findall(nodes.Text)):
        parts = NUMBER.split(text.astext())
        if len(parts) == 1 or isinstance(
            text.parent, nodes.literal | nodes.FixedTextElement | nodes.math | nodes.title
        ):
            continue
        # Every second part is a number.
        found = [
            nodes.inline("", part, classes=["number"]) if i % 2 else nodes.Text(part)
            for i, part in enumerate(parts)
        ]
        text.parent.replace(text, [node for node in found if node.astext()])


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("doctree-resolved", keep_together)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
