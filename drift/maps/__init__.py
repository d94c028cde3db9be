"""The drawing kit of every map.py: charts, pages and labels. It knows no topic; each topic's map.py says what stands where."""
