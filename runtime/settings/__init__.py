"""Settings of any program: from TOML to frozen models, any mistake in one line."""
