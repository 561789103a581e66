"""Sensors, one file each: format, measurement model and simulator; `spinfilters.models.sensor_registry` names them."""
