"""The generated layout is the DBC's."""

from steer_by_wire.dbc.contract.layout_from_dbc import FILE, generated_text


def test_the_generated_layout_is_what_the_dbc_gives_byte_for_byte() -> None:
    found = FILE.read_bytes()
    expected = generated_text().encode("ascii")
    assert found == expected, "run python -m steer_by_wire.dbc.contract.layout_from_dbc"
