"""The import package: public names, the one command, and what several programs share."""
