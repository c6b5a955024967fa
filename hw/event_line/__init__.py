"""What puts a voltage edge where an EEG amplifier, a motion capture or a camera takes one."""
