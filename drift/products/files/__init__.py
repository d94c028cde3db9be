"""Writing of results: a results folder is either complete or not there at all."""
