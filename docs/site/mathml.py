"""Formulae as MathML, which browsers draw without a script."""

import re

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

OF_OUR_PAGES = (
    (r"\\(begin|end)\{aligned\}", r"\\\1{align*}"),
    (r"\\operatorname\{(\w*\d\w*)\}", r"\\text{\1}"),
)
"""What the pages write otherwise than the converter reads it."""


def mathml(latex: str, display: str) -> str:
    """Return a formula, ``inline`` or as a ``block``. Raises ValueError where a part of it is not understood."""
    for ours, theirs in OF_OUR_PAGES:
        latex = re.sub(ours, theirs, latex)
    formula = convert(latex, display=display)
    if left := re.search(r"<m[ion]>(&|\\[^<]+)</m", formula):
        raise ValueError(f"{left[1]} is not understood in {latex}")
    return formula


def _inline(translator: HTML5Translator, node: nodes.math) -> None:
    translator.body.append(mathml(node.astext(), "inline"))
    raise nodes.SkipNode


def _block(translator: HTML5Translator, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="formula">{mathml(node.astext(), "block")}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Register the renderer."""
    app.add_html_math_renderer("mathml", inline_renderers=(_inline, None), block_renderers=(_block, None))
