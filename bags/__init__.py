"""Recordings: reading and writing bags, and the bundled samples."""
