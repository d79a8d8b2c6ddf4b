"""Colours for `.lf` files in the handbook."""

from __future__ import annotations

from typing import ClassVar

from pygments.lexer import RegexLexer, bygroups, using, words
from pygments.lexers.python import PythonLexer
from pygments.token import Comment, Keyword, Name, Number, Operator, Punctuation, String, Text
from sphinx.application import Sphinx

KEYWORDS = (
    "action after as at const deadline extends federated from history import initial input",
    "interleaved logical main maxwait method mode mutable new output physical preamble private",
    "public reaction reactor realtime reset serializer shutdown startup state STP tardy target",
    "timer widthof",
)
UNIT = r"nsecs?|ns|usecs?|us|msecs?|ms|secs?|s|minutes?|mins?|m|hours?|h|days?|d|weeks?"


class LinguaFrancaLexer(RegexLexer):
    """Splits a program into words; its bodies, between `{=` and `=}`, are Python."""

    name = "Lingua Franca"
    aliases: ClassVar = ["lf"]
    tokens: ClassVar = {
        "root": [
            (r"\s+", Text.Whitespace),
            (r"(//|#).*$", Comment.Single),
            (r"/\*(.|\n)*?\*/", Comment.Multiline),
            (r"(\{=)((?:.|\n)*?)(=\})", bygroups(Punctuation, using(PythonLexer), Punctuation)),
            (r'"(\\.|[^"\\])*"', String),
            (words(" ".join(KEYWORDS).split(), prefix=r"\b", suffix=r"\b(?![-:])"), Keyword),
            (r"\b(true|false|forever|never)\b", Keyword.Constant),
            (rf"(\d[\d_]*(?:\.\d+)?)(\s*)({UNIT})\b", bygroups(Number, Text, Keyword.Type)),
            (r"\d[\d_]*(?:\.\d+)?", Number),
            (r"[A-Za-z_][\w-]*", Name),
            (r"->|~>|[-+*/=:&|<>?!]", Operator),
            (r"[{}()\[\],;.@]", Punctuation),
            (r".", Text),
        ]
    }


def setup(app: Sphinx) -> dict[str, bool]:
    """Teaches Sphinx the language."""
    app.add_lexer("lf", LinguaFrancaLexer)
    return {"parallel_read_safe": True}
