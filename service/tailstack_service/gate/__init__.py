"""The gate: designs held to a policy, with findings at the line of the offending value and an exit code.

A reader who follows one design meets these rooms in this order: ``asked`` (what a gate can be asked with), ``request``
(what came over HTTP) or the command, which read ``policy``, ``waivers`` and ``baseline`` by way of ``reading``;
``judge``, which scores, plans and concludes; ``case``, a design with what it is asked for and the numbers held against
that; ``rules``, the table of what is looked for, found by ``design_rules``, ``baseline`` and ``case``; ``records``, the
answer; ``text`` and ``formats``, which write it.
"""
