"""Where data and model disagree, which effect is missing, proof on unseen data, and the next
experiment.
"""
