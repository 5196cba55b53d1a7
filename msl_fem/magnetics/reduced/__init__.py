"""The field in a space of a few solutions: tables from some twenty of them, with a certificate."""
