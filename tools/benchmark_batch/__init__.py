"""How fast compiled runs are: beside plain C of the same arithmetic, and beside other tools."""
