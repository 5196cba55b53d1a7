"""Comparative model accuracy: how far each model is from a record, where, and against which floor."""
