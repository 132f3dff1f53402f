"""What the DBC file says, as Python: enumerations, a record for each message, the generator."""
