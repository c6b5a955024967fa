"""What is contact: rough skin on a flat screen, the distribution of its gaps, and the integrals
over them.
"""
