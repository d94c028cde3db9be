"""Objects that drift: their leeway, and the everyday words for them."""
