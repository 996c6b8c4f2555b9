"""Gives the words of a command line to Hydra such that a text stays what was written.

Hydra's grammar reads a value as a number, a list or a call before anything else. A text would
become another one (`results_dir=1234e567` the folder `inf`) or none (`results_dir=out#2`). So a
word is quoted for Hydra here, and nowhere else:

    texts    results_dir, executor.partition          the whole value, commas included
    names    system, controller/sampler, precision    the names between commas
    others   theta, problem.prior_mean                not quoted

`${...}` in a text refers to another setting, as everywhere in a configuration; `\\${` is the
characters themselves.
"""

import re
from collections.abc import Collection

from .request import key_of
from .text_keys import CHOICES, OPTIONAL_TEXTS, TEXTS

NAME = re.compile(r"\w[\w.-]*")  # of an option of a group
NULL = "null"  # the word for no value, in any case


def word_for_hydra(word: str, groups: Collection[str]) -> str:
    """Returns a word KEY=VALUE such that Hydra reads a text as it is written.

    `groups` are the names of the groups of options. Other words are returned as they are.
    """
    key_and_signs, equals, value = word.partition("=")
    if not equals or word.startswith("~"):
        return word
    key = key_of(word)
    if key in TEXTS:
        if key in OPTIONAL_TEXTS and value.lower() == NULL:
            return word
        return f"{key_and_signs}={quoted(value)}"
    if key in CHOICES or key.partition("@")[0] in groups:
        names = [name.strip() for name in value.split(",")]
        if all(NAME.fullmatch(name) for name in names):
            return f"{key_and_signs}={','.join(map(quoted, names))}"
    return word


def quoted(text: str, *, double: bool = False) -> str:
    """Returns a text in the quotes of Hydra's grammar."""
    from hydra.core.override_parser.types import Quote, QuotedString

    quote = Quote.double if double else Quote.single
    return QuotedString(text=text, quote=quote).with_quotes()
