# SPDX-License-Identifier: GPL-3.0-or-later
"""Operations that change captures: selection, flags, transforms, painting, duplication, clean-up, and their history.

| to …                                         | see                                              |
|----------------------------------------------|--------------------------------------------------|
| hold a capture that can be edited            | `editable_cloud`                                 |
| say which splats: one bit each               | `mask`, and `state` for the flags of a splat     |
| find splats                                  | `match_*`                                        |
| select, delete, hide, lock                   | `selection`, `flags`                             |
| transform, paint, duplicate, merge, clean up | `transform*`, `paint*`, `duplicate`, `clean_up`  |
| do, undo and redo                            | `history`                                        |
| edit a capture that stays in its file        | `capture_edits`, `capture_cloud`, `edited_*`     |
| keep such edits in a file of their own       | `edits_file`                                     |

design/editing.md says how it fits together.
"""
