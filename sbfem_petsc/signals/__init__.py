"""Signals: functions of time that drive forces, tractions or the motion of a support.

A signal is a frozen value: called with times (s) it gives values of the same shape, in the unit of what it
drives (N as a component of a force). Signals add with `+`, also with numbers, and are scaled with `*` and
`/`.
"""
