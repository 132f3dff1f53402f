"""Challenges are answered in turn, once for each new message."""

from random import Random

from steer_by_wire.dbc.secoc.authentication import Challenges


def drive(random: Random) -> None:
    """Send new and recorded challenges, and compare with what the documents say."""
    kept = Challenges()
    newest: list[tuple[int, bytes]] = []  # by counter
    waiting: list[bytes] = []
    sent = [(b"first", 0)]
    for _ in range(120):
        if random.random() < 0.4:
            assert kept.answer() == (waiting.pop(0) if waiting else None)
            continue
        if random.random() < 0.8:
            sent.append((bytes([random.randrange(24)]), random.randrange(2**32)))
        challenge, counter = random.choice(sent[-30:])
        known = [one for one, name in newest if name == challenge]
        is_new = not known or counter > known[0]
        assert kept.add(challenge, counter) is is_new
        if not is_new:
            continue
        newest = sorted([*(one for one in newest if one[1] != challenge), (counter, challenge)])
        waiting += [challenge] if challenge not in waiting else []
        if len(newest) > 16:
            (_, forgotten), *newest = newest
            waiting = [one for one in waiting if one != forgotten]


def test_challenges_are_answered_in_turn_once_each() -> None:
    for number in range(60):
        drive(Random(number))
