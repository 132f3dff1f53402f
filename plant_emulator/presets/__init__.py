"""Settings that are shipped with the package, one TOML file each.

Not here: what a key means (``settings``, and the table's own module). Begin with
``paper_nominal.toml``.
"""
