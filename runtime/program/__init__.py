"""What live programs share: options, signals, the screen, the report and the exit status."""
