# SPDX-License-Identifier: GPL-3.0-or-later
"""Jobs: options, plan, render, merge and the programs that follow a render. Imports all rooms but ui."""
