"""Write the report of a stress study: a page, its pictures, and the expected cost."""
