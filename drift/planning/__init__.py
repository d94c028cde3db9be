"""The next search: by units, by patrols along a coast, by towed arrays."""
