"""Recordings: reading and writing bags, the bundled sample and its maker."""
