"""The Siglent SDG1000X and SDG2000X: driver, last gate and simulator."""
