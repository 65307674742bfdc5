"""The form that all decision records have."""

import pytest

from docs.site import decisions


def test_every_record_has_the_form_and_is_in_the_index():
    records = decisions.records()
    numbers = [d.number for d in records]
    assert numbers == sorted(set(numbers))
    assert {d.superseded_by for d in records} - {None} <= set(numbers)
    index = decisions.index()
    assert all(f"[{d.title}]({d.file})" in index for d in records)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("# 0007: A title\n\nStatus: accepted.\n", r'expected "# 7\. TITLE"'),
        ("# 8. A title\n\nStatus: accepted.\n", r'expected "# 7\. TITLE"'),
        ("# 7. A title\n\n**Decision.** So.\n", 'expected "Status: accepted"'),
        ("# 7. A title\n\nStatus: measured.\n", 'expected "Status: accepted"'),
        ("# 7. A title\n", 'expected "Status: accepted"'),
    ],
)
def test_another_form_is_refused(tmp_path, text, said):
    (tmp_path / "0007-a-title.md").write_text(text, encoding="utf-8")
    with pytest.raises(decisions.FormError, match=said):
        decisions.read(tmp_path / "0007-a-title.md")


def test_a_superseded_record_names_its_successor(tmp_path):
    path = tmp_path / "0007-a-title.md"
    path.write_text(
        "# 7. A title\n\nStatus: superseded by [8](0008-b.md), for it was wrong.\n", encoding="utf-8"
    )
    assert decisions.read(path).superseded_by == 8
