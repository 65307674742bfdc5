"""Signatures in minisign's form: a known one of its own, and every way in which one must not hold."""

import base64
import stat
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from service.analysis.evidence.signature import check, public_key, read_public_key, secret_key, sign
from service.errors import InputError, StoreError

DATA = b"what is signed\n"


@pytest.fixture(scope="module")
def key() -> Ed25519PrivateKey:
    return Ed25519PrivateKey.from_private_bytes(bytes(range(32)))


def test_a_signature_holds_and_has_minisigns_form(key):
    text = sign(key, DATA, "said beside it")
    lines = text.splitlines()
    assert lines[0].startswith("untrusted comment: ")
    raw = base64.b64decode(lines[1])
    assert (raw[:2], len(raw)) == (b"ED", 74)
    assert check(public_key(key), DATA, text) == "said beside it"
    assert check(read_public_key(public_key(key).text), DATA, text) == "said beside it"
    assert check(read_public_key(public_key(key).text.splitlines()[1]), DATA, text) == "said beside it"


@pytest.mark.parametrize("line", [1, 2, 3])
def test_a_changed_signature_does_not_hold(key, line):
    lines = sign(key, DATA, "comment").splitlines()
    at = len(lines[line]) // 2
    lines[line] = lines[line][:at] + ("A" if lines[line][at] != "A" else "B") + lines[line][at + 1 :]
    with pytest.raises(StoreError):
        check(public_key(key), DATA, "\n".join(lines))


def test_other_data_or_another_key_is_refused(key):
    text = sign(key, DATA, "comment")
    with pytest.raises(StoreError, match="does not hold"):
        check(public_key(key), DATA + b" ", text)
    with pytest.raises(StoreError, match="another key"):
        check(public_key(Ed25519PrivateKey.from_private_bytes(bytes(32))), DATA, text)


@pytest.mark.parametrize("text", ["", "untrusted comment: x\nAAAA\n", "no base64 at all!", "a" * 10_000])
def test_what_is_no_key_or_signature_is_told_in_a_sentence(key, text):
    with pytest.raises(StoreError):
        read_public_key(text)
    with pytest.raises(StoreError):
        check(public_key(key), DATA, text)


def test_a_secret_key_is_made_once_and_its_owners_alone(tmp_path: Path):
    path = tmp_path / "secret.pem"
    first, new = secret_key(path)
    assert new
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    again, new = secret_key(path)
    assert not new
    assert public_key(again).text == public_key(first).text
    path.chmod(0o644)
    with pytest.raises(InputError, match="read by others"):
        secret_key(path)
    (tmp_path / "other.pem").write_text("nothing")
    (tmp_path / "other.pem").chmod(0o600)
    with pytest.raises(InputError, match="no key"):
        secret_key(tmp_path / "other.pem")
