"""What a control step and a run in virtual time cost here."""
