"""A car's dialect: a first file from a database, and what is missing in one."""
