"""Every law over every delay: how far each leaves the path, and where it breaks."""
