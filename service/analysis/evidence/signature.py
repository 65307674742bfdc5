"""Ed25519 signatures in the form of minisign (https://jedisct1.github.io/minisign), made by `cryptography`.

Whoever has minisign checks a folder's manifest without tailroad: `minisign -Vm manifest.json -p tailroad.pub`. The
secret key is a PKCS #8 file of its own, readable by its owner alone.
"""

import base64
import binascii
import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from service.errors import InputError, StoreError

KEY_ALGORITHM, HASHED = b"Ed", b"ED"  # of keys, and of signatures of a file's BLAKE2b hash
LONGEST = 4096  # characters of a key or a signature


@dataclass(frozen=True)
class PublicKey:
    """Whose signatures are believed. id: 8 bytes that name it."""

    id: bytes
    key: Ed25519PublicKey

    @property
    def name(self) -> str:
        """As minisign shows it."""
        return self.id[::-1].hex().upper()

    @property
    def text(self) -> str:
        """As its file has it."""
        raw = self.key.public_bytes(serialization.Encoding.Raw, serialization.PublicFormat.Raw)
        line = base64.b64encode(KEY_ALGORITHM + self.id + raw).decode()
        return f"untrusted comment: minisign public key {self.name}\n{line}\n"


def _id_of(key: Ed25519PublicKey) -> bytes:
    raw = key.public_bytes(serialization.Encoding.Raw, serialization.PublicFormat.Raw)
    return hashlib.blake2b(raw, digest_size=8).digest()


def secret_key(path: Path) -> tuple[Ed25519PrivateKey, bool]:
    """The key in a file, and whether it was made just now, as there was none.

    InputError for a file that holds no Ed25519 key, or that others may read.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return _made(path), True
    except OSError as error:
        raise InputError(f"cannot read the key {path}: {error.strerror or error}") from error
    if path.stat().st_mode & 0o077:
        raise InputError(f"the key {path} can be read by others; chmod 600 it, or make a new one")
    try:
        key = serialization.load_pem_private_key(data, None)
    except (ValueError, TypeError) as error:
        raise InputError(f"{path} is no key without a password in PKCS #8 (PEM)") from error
    if not isinstance(key, Ed25519PrivateKey):
        raise InputError(f"{path} is no Ed25519 key")
    return key, False


def _made(path: Path) -> Ed25519PrivateKey:
    key = Ed25519PrivateKey.generate()
    data = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except OSError as error:
        raise InputError(f"cannot write a new key to {path}: {error.strerror or error}") from error
    with os.fdopen(handle, "wb") as out:
        out.write(data)
    return key


def public_key(key: Ed25519PrivateKey) -> PublicKey:
    """The public key that belongs to a secret one."""
    public = key.public_key()
    return PublicKey(_id_of(public), public)


def read_public_key(text: str) -> PublicKey:
    """A public key as minisign writes it, with its comment or the line alone; StoreError for anything else."""
    lines = [line for line in text[:LONGEST].splitlines() if line.strip()]
    raw = _decoded(lines[-1] if lines else "", 42, "public key")
    if raw[:2] != KEY_ALGORITHM:
        raise StoreError("the public key is of another algorithm than Ed25519")
    return PublicKey(raw[2:10], Ed25519PublicKey.from_public_bytes(raw[10:]))


def sign(key: Ed25519PrivateKey, data: bytes, comment: str) -> str:
    """The signature of a file's content as minisign writes it; comment: signed, too."""
    public = public_key(key)
    signature = key.sign(hashlib.blake2b(data).digest())
    whole = key.sign(signature + comment.encode())
    return (
        f"untrusted comment: signature from tailroad, key {public.name}\n"
        f"{base64.b64encode(HASHED + public.id + signature).decode()}\n"
        f"trusted comment: {comment}\n{base64.b64encode(whole).decode()}\n"
    )


def check(key: PublicKey, data: bytes, text: str) -> str:
    """The comment of a signature that holds; StoreError says why another does not."""
    lines = text[:LONGEST].splitlines()
    if len(lines) != 4 or not lines[2].startswith("trusted comment: "):
        raise StoreError("the signature is not in the form of minisign")
    raw, whole = _decoded(lines[1], 74, "signature"), _decoded(lines[3], 64, "signature's comment")
    if raw[:2] != HASHED:
        raise StoreError("the signature is of another algorithm than hashed Ed25519")
    if raw[2:10] != key.id:
        raise StoreError(f"the signature was made with another key than {key.name}")
    comment = lines[2].removeprefix("trusted comment: ")
    try:
        key.key.verify(raw[10:], hashlib.blake2b(data).digest())
        key.key.verify(whole, raw[10:] + comment.encode())
    except InvalidSignature as error:
        raise StoreError("the signature does not hold: the manifest or the signature was changed") from error
    return comment


def _decoded(line: str, size: int, what: str) -> bytes:
    try:
        raw = base64.b64decode(line, validate=True)
    except (binascii.Error, ValueError) as error:
        raise StoreError(f"the {what} is no base64") from error
    if len(raw) != size:
        raise StoreError(f"the {what} has {len(raw)} bytes, not {size}")
    return raw
