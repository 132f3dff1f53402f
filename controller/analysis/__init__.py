"""Design-time analysis of the loop: for ``--check`` and the tools; a running node imports none."""
