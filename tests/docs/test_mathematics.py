"""Formulas in Markdown."""

import markdown
import pytest


def html(text: str) -> str:
    return markdown.markdown(text, extensions=["docs.site.mathematics", "tables"])


def test_formulas_become_mathml_within_a_line_and_as_a_block():
    assert '<math xmlns="http://www.w3.org/1998/Math/MathML" display="inline">' in html(
        r"so $f(x) \le \gamma$."
    )
    assert 'display="block"' in html("$$\np = \\frac{1}{N}\n$$")
    assert "<msub><mi>x</mi><mn>1</mn></msub>" in html("| a | b |\n| --- | --- |\n| $x_1$ | $*y*$ |")


@pytest.mark.parametrize("text", ["$HOME and $PATH", "it costs $5 or $6", "`$x$`", r"\$x\$", "a $ b $ c"])
def test_other_dollar_signs_are_left_alone(text):
    assert "<math" not in html(text)


def test_a_command_that_would_be_shown_as_it_is_written_is_refused():
    with pytest.raises(ValueError, match="does not know"):
        html(r"$\nosuchthing{x}$")
