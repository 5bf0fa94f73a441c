"""`python binopos_ros/nodes/__main__.py NAME [NAME ...]`: nodes composed in this process.

With --spare it imports what any node needs, and waits for the words on its standard input.
"""

from __future__ import annotations

import os
import sys

# Python puts the folder of this file, or with -m the working folder, before all else; whatever
# lies there would be imported in the place of what the nodes mean.
_HERE = os.path.dirname(os.path.abspath(__file__))
if sys.path[0] in (_HERE, os.getcwd()):
    sys.path[:1] = []
    sys.path.append(os.path.dirname(os.path.dirname(_HERE)))

from binopos_ros.nodes.supervised import prepare  # noqa: E402 (the path first)

prepare()

from binopos_ros.nodes.compose import compose, compose_later  # noqa: E402 (signals first)

sys.exit(compose_later() if sys.argv[1:] == ['--spare'] else compose(sys.argv[1:]))
