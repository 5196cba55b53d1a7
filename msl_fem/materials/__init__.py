"""Irons, copper, core losses and constants of nature, with their data."""
