# SPDX-License-Identifier: GPL-3.0-or-later
"""What Stipple raises when the cause lies outside it."""


class StippleError(Exception):
    """A problem the user can fix: one sentence with the file or setting, the property and the fix.

    Hosts show the text as it is (the command line after `error:`, Blender as a report) and never a traceback.
    """


class DeviceError(StippleError):
    """A device is not there, or its memory does not suffice: on another device the same picture may succeed."""


class Cancelled(Exception):
    """The host asked to stop; raised between launches, and what was accumulated stays valid.

    Only inside `giving_way.giving_way` launches are cut short as well, and what was accumulated is lost.
    """
