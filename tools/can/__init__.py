"""Show frames bit by bit, and write them as waveforms."""
