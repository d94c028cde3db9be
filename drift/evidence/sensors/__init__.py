"""What a sensor hears or sees where: the sonar equation, its tables, and POD by place."""
