"""A small town to drive in: roads, traffic, a car, a camera. It knows nothing of HPRM.

One seed makes one town with all that happens in it. The same controls give the same frames, bit for
bit: there is no clock in it, no thread, and no order that is not fixed.
"""
