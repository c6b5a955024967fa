"""Pages and docstrings keep to short sentences and to the words of the field, without exception."""

import re

import pytest

from tests.docs.plain_english import LONGEST_WORDS, NOT_OURS, PAGES, of_docstrings, of_pages


@pytest.fixture(scope="module", params=[of_pages, of_docstrings], ids=["pages", "docstrings"])
def sentences(request):
    return list(request.param())


def test_no_sentence_is_longer_than_a_reader_can_hold(sentences):
    long = [f"{s.where}: {s.text}" for s in sentences if s.words > LONGEST_WORDS]
    assert not long, "\n".join(long)


def test_words_are_those_of_the_field(sentences):
    found = [
        (s.where, word, s.text)
        for s in sentences
        for word in NOT_OURS
        if re.search(rf"\b{word}\b", s.text, re.IGNORECASE)
    ]
    assert not found, "\n".join(f"{where}: '{word}' in: {text}" for where, word, text in found)


@pytest.mark.parametrize(
    "page", [page for page in PAGES if page.parent.name == "docs"], ids=lambda page: page.name
)
def test_the_first_line_says_for_whom_the_page_is(page):
    title, first = page.read_text(encoding="utf-8").split("\n\n")[:2]
    assert title.startswith("# ")
    assert re.match(r"For (people|programmers|every reader)\b", first), first


def test_every_term_of_the_glossary_is_defined_once():
    (page,) = [page for page in PAGES if page.name == "glossary.md"]
    terms = re.findall(r"^\| ([^|]+) \|", page.read_text(encoding="utf-8"), re.MULTILINE)[1:]
    assert len(terms) == len(set(terms)) >= 30
