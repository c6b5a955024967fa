"""What is electric: layers of insulator, gap and skin, the circuit they make, charges over time,
current.
"""
