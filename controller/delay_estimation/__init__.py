"""The delay from command and response, without an echo; no law uses it."""
