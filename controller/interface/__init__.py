"""What every law is given, returns and must obey; begin at `law.py`."""
