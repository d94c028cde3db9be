"""The drawing kit: charts, pages and labels. It knows no topic."""
