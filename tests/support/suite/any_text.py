"""Any text that a file can hold: all characters but halves of UTF-16's pairs.

``text()`` of hypothesis finds the same ones by encoding each there is, which takes two seconds.
"""

from hypothesis import strategies as st

ANY_CHARACTER = st.characters(exclude_categories=["Cs"])
