"""A Sphinx extension: equations as MathML, which browsers draw themselves, without a network and without a script."""

import re
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx

# Browsers know bold letters only as characters of their own.
BOLD_ITALIC_A, BOLD_ITALIC_CAPITAL_A = 0x1D482, 0x1D468
FUNCTION = r"<mi>(?:sin|cos|tan|sinh|cosh|tanh|asinh|arcsin|arctan|ln|exp)</mi>"
SPACE = '<mspace width="0.17em"/>'


def mathml(latex: str, display: str) -> str:
    text = convert(latex, display=display)
    text = re.sub(r'<mi mathvariant="bold">([A-Za-z])</mi>', lambda found: f"<mi>{bold(found[1])}</mi>", text)
    # The character of a prime is raised already.
    text = re.sub(
        r"<msup>(<mi>[^<]*</mi>)<mi>(&#x0203[23];)</mi></msup>", r'\1<mo lspace="0" rspace="0">\2</mo>', text
    )
    # Space between the name of a function and its neighbours.
    text = re.sub(
        rf"((?<!<msup>){FUNCTION}|<msup>{FUNCTION}<m\w>[^<]*</m\w></msup>)(?=<m[insu])", rf"\1{SPACE}", text
    )
    return re.sub(rf"(</m(?:i|n|sub|sup)>)(?=(?:<msup>)?{FUNCTION})", rf"\1{SPACE}", text)


def bold(letter: str) -> str:
    start = BOLD_ITALIC_A - ord("a") if letter.islower() else BOLD_ITALIC_CAPITAL_A - ord("A")
    return chr(start + ord(letter))


def inline(writer: Any, node: nodes.math) -> None:
    writer.body.append(mathml(node.astext(), "inline"))
    raise nodes.SkipNode


def parts(latex: str) -> list[str]:
    """The equations of a line, which wide spaces separate: on a narrow page each gets its own line."""
    found, depth = [""], 0
    for word in re.split(r"(\\qquad|\\left\b|\\right\b|[{}])", latex):
        depth += (word in ("{", "\\left")) - (word in ("}", "\\right"))
        if word == r"\qquad" and depth == 0:
            found.append("")
        else:
            found[-1] += word
    found = [part.strip() for part in found if part.strip()]
    # The number stays beside the last one.
    return (
        [*found[:-2], rf"{found[-2]} \qquad {found[-1]}"]
        if re.fullmatch(r"\(.*\)", found[-1]) and found[1:]
        else found
    )


def display(writer: Any, node: nodes.math_block) -> None:
    drawn = "".join(mathml(part, "block") for part in parts(node.astext()))
    writer.body.append(f'<div class="equation">{drawn}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_html_math_renderer("mathml", (inline, None), (display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
