"""What a device measures of itself, with seeded noise, delays and dropouts."""
