"""Pages of the documentation that are made when it is built; its modules but `site` are read
without Sphinx, by the tests too.
"""
