"""Damage to files: what bad disks, broken copies and hostile hands do to bytes and to YAML."""

from __future__ import annotations

import random
import re
from collections.abc import Callable

BOUNDS = (0, 1, 2, 0x7F, 0xFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**32, 2**63 - 1, 2**63, 2**64 - 1)
"""Values of length fields at which readers go wrong."""

SCALARS = (
    '.nan', '-.inf', '1e400', '-0.0', '1e-400', '9' * 5000, '0x7fffffff', '0b11', '010', '1_000', '1:30', '2024-02-30',
    'null', '~', 'true', 'off', '""', "''", '" "', '"\\0"', '"\\u202e\\ufeff"', '"\\ud800"',
    'ｌ１', '٣', '½', '𝟛', 'e\u0301',
    '"<script>alert(1)</script>"', '"&lt;\'"', '"{{ 7 * 7 }}"', '"$(touch canary)"', '"; DROP TABLE"', '"%s%n"',
    '[]', '{}', '[[]]', '[1, 2, 3]', '{a: 1}', '- 1', '|\n  text', '>\n  text', '? 1', '@a', '`a`', '%a', '*a', '&a 1',
    '&a [*a, *a]', '{<<: *a}', '!!str 1', '!!binary aGk=', '!!set {a, b}', '!!float 1', '!local 1',
    '!<tag:yaml.org,2002:int> 1', '!!python/name:os.system',
    '!!python/object/apply:os.mkdir [canary]', '!!python/object/new:os.mkdir {args: [canary]}',
    '[' * 50, '{a: ' * 50, '[' * 2000, '- ' * 300, 'x' * 70_000,
    '"', "'", '#', ':', '-', ',', ']', '}', '---', '...', '\t',
)  # fmt: skip
"""Values that people, other programs and attackers write where another is expected."""

TEXTS = (
    '%YAML 1.2\n---\n', '%TAG ! tag:yaml.org,2002:python/\n---\n', '---\n', '...\n',
    '\ufeff', '\u2028', '\x85', '\x07', '\0', '\r', '\t', '# ', '"', "'", '[', '}', ': ', '- ', '? ', '|', '&x ', '*x',
    '<<: ', '!!python/object/apply:os.mkdir [canary]',
)  # fmt: skip
"""What may stand anywhere in a text."""

_TOKEN = re.compile(r'[A-Za-z_/][A-Za-z0-9_/]*|[-+.0-9][-+.e0-9]*')

Damage = Callable[[bytearray, bytes, random.Random], None]


def mutated(content: bytes, other: bytes, rng: random.Random) -> bytes:
    """The bytes of a file with one to three kinds of damage; never as they were, unless empty.

    Args:
        content: the file.
        other: where foreign bytes come from.
        rng: chooses the damage.
    """
    data = bytearray(content)
    while content and data == content:
        for _ in range(rng.choice((1, 1, 1, 2, 3))):
            if data:
                rng.choice(DAMAGES)(data, other, rng)
    return bytes(data)


def mutated_yaml(text: str, rng: random.Random) -> bytes:
    """A YAML text in which values, keys or lines are no longer what they were."""
    before = text
    while text == before:
        for _ in range(rng.choice((1, 1, 1, 2, 3))):
            text = rng.choice((*3 * (_other_token,), _other_value, _insertion, _lines))(text, rng)
    content = text.encode('utf-8', 'surrogatepass')
    if rng.random() < 0.2:
        content = mutated(content, content, rng)
    elif rng.random() < 0.03:
        content = text.encode(rng.choice(('utf-16', 'utf-32', 'cp037')), 'replace')
    return content


def _flip(data: bytearray, _: bytes, rng: random.Random) -> None:
    for _ in range(rng.choice((1, 1, 1, 2, 8))):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def _overwrite(data: bytearray, _: bytes, rng: random.Random) -> None:
    at, size = rng.randrange(len(data)), _size(rng)
    kind = rng.randrange(3)
    data[at : at + size] = rng.randbytes(size) if kind == 0 else (b'\0' if kind == 1 else b'\xff') * size


def _cut(data: bytearray, _: bytes, rng: random.Random) -> None:
    del data[rng.randrange(len(data)) :]


def _insert(data: bytearray, _: bytes, rng: random.Random) -> None:
    at = rng.randrange(len(data) + 1)
    data[at:at] = rng.randbytes(_size(rng))


def _delete(data: bytearray, _: bytes, rng: random.Random) -> None:
    at = rng.randrange(len(data))
    del data[at : at + _size(rng)]


def _splice(data: bytearray, other: bytes, rng: random.Random) -> None:
    """A piece of another file, in place of as much, or between."""
    size = _size(rng)
    start, at = rng.randrange(max(1, len(other))), rng.randrange(len(data))
    piece = other[start : start + size]
    data[at : at + (len(piece) if rng.random() < 0.5 else 0)] = piece


def _repeat(data: bytearray, _: bytes, rng: random.Random) -> None:
    """A piece of the same file once more, somewhere else."""
    start, at = rng.randrange(len(data)), rng.randrange(len(data))
    data[at:at] = data[start : start + _size(rng)]


def _length(data: bytearray, _: bytes, rng: random.Random) -> None:
    """Another number where a length, an offset or a count may stand."""
    width, order = rng.choice((2, 4, 4, 4, 8)), rng.choice(('little', 'little', 'big'))
    for _ in range(64):
        at = rng.randrange(len(data))
        value = int.from_bytes(data[at : at + width], order)
        if 0 < value <= len(data):
            break
    new = rng.choice((*BOUNDS, value + 1, value - 1, 2 * value, len(data), len(data) + 1))
    data[at : at + width] = (new % (1 << 8 * width)).to_bytes(width, order)


DAMAGES: tuple[Damage, ...] = (_flip, _flip, _overwrite, _cut, _insert, _delete, _splice, _repeat, _length, _length)


def _size(rng: random.Random) -> int:
    return rng.choice((1, 2, 4, 8, rng.randrange(1, 64), rng.randrange(1, 5000)))


def _other_token(text: str, rng: random.Random) -> str:
    """Another word or number in place of one that stands there."""
    tokens = list(_TOKEN.finditer(text))
    if not tokens:
        return text
    token = rng.choice(tokens)
    own = rng.choice(tokens)[0]
    foreign = rng.choice(SCALARS)
    new = rng.choice((foreign, foreign, own, f'-{token[0]}', token[0][:-1], token[0] + token[0][-1]))
    return text[: token.start()] + new + text[token.end() :]


def _other_value(text: str, rng: random.Random) -> str:
    """Another value behind a colon, up to the end of the line."""
    colons = [match.end() for match in re.finditer(': ', text)]
    if not colons:
        return text
    at = rng.choice(colons)
    end = text.find('\n', at)
    return text[:at] + rng.choice(SCALARS) + text[end if end >= 0 else len(text) :]


def _insertion(text: str, rng: random.Random) -> str:
    at = rng.choice((0, rng.randrange(len(text) + 1)))
    return text[:at] + rng.choice((*TEXTS, rng.choice(SCALARS))) + text[at:]


def _lines(text: str, rng: random.Random) -> str:
    """A line less, twice, elsewhere, deeper, or another in its place."""
    lines = text.split('\n')
    here, there = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(5)
    if kind == 0:
        del lines[here]
    elif kind == 1:
        lines.insert(there, lines[here])
    elif kind == 2:
        lines.insert(there, lines.pop(here))
    elif kind == 3:
        lines[here] = ' ' * rng.randrange(1, 5) + lines[here]
    else:
        lines[here] = rng.choice(SCALARS)
    return '\n'.join(lines)
