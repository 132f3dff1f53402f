"""Run, resume and replay stress studies."""
