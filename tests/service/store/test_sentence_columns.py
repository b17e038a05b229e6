"""Tests of columns that store sentences with their codes, also next to plain texts of older releases."""

from __future__ import annotations

from typing import Any

from sqlalchemy import Column, Integer, MetaData, Table, Text, create_engine, select, text

from renderer.sentences import Sentence
from service.store.sentence_columns import SentenceList, SentenceRecord, SentenceText

SAID = Sentence("film-locked", "The film of {job} is locked.", job="j1")
ROWS = Table(
    "rows",
    MetaData(),
    Column("id", Integer, primary_key=True),
    Column("error", SentenceText),
    Column("notes", SentenceList),
    Column("info", SentenceRecord),
    Column("plain", Text),
)


def test_sentence_codes_are_stored_and_plain_texts_unchanged() -> None:
    engine = create_engine("sqlite://")
    ROWS.metadata.create_all(engine)
    info: dict[str, Any] = {"warnings": [SAID, "Old."], "counts": {"lights": 1}}
    with engine.begin() as connection:
        connection.execute(ROWS.insert().values(id=1, error=SAID, notes=["Old.", SAID], info=info))
        old = 'INSERT INTO rows VALUES (2, \'It broke {"code": 1}.\', \'["Old."]\', \'{"warnings": ["Old."]}\', NULL)'
        connection.execute(text(old))
        connection.execute(ROWS.insert().values(id=3, error=None, notes=None, info=None))
        connection.execute(text("UPDATE rows SET error = '{\"code\": broken' WHERE id = 3"))
        new, former, none = connection.execute(select(ROWS).order_by(ROWS.c.id)).all()
    assert isinstance(new.error, Sentence) and new.error == SAID and new.error.coded == SAID.coded
    assert new.notes == ["Old.", SAID] and new.notes[1].code == "film-locked"
    assert new.info == info and new.info["warnings"][0].params == {"job": "j1"}
    assert (former.error, former.notes, former.info) == ('It broke {"code": 1}.', ["Old."], {"warnings": ["Old."]})
    assert not isinstance(former.error, Sentence)
    assert (none.error, none.notes, none.info) == ('{"code": broken', None, None)
    engine.dispose()
