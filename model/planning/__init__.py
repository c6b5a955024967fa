"""What a setting would tell apart: before a plan is measured, after a verdict, and in the loop."""
