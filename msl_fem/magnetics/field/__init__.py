"""Kinds of magnet: section, field, force by two routes."""
