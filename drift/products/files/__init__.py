"""The one writer of results: a folder is whole or not there at all."""
