"""What planned searches would find."""
