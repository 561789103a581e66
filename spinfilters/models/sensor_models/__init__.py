"""One file per sensor."""
