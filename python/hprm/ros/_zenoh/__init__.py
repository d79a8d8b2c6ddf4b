"""The bridge to nodes of ROS 2 that run elsewhere, over the protocol of ``rmw_zenoh``.

``keys``, ``tokens``, ``attachment`` and ``numbers`` are pure: what the protocol writes, and how it
is read. ``graph`` is what the nodes elsewhere have, as data, and ``arrivals`` a queue. ``session``
opens the session of Zenoh, ``endpoints`` is what scripts have in it, and ``bridge`` the driver
between both and the hub of the scripts.
"""
