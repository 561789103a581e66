"""Tables and figures of Tweddle (2013), a file each."""
