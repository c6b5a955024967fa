"""What switches off when nothing else does: interlock and watchdog."""
