"""Hand wheels that are shipped with the package, one TOML file each.

Not here: what a key means (``settings``). Begin with ``still.toml``.
"""
