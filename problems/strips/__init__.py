"""Aircraft made of lifting strips, as a truth unlike the model of casid.

No derivative is written down here. Strips of wing, tail, fin and fuselage see their own flow: the rotation of the body,
the air at their place, the slipstream of a propeller and, at the tail, the downwash that left the wing earlier. They
stall one by one. Pilots and autopilots fly some of the records. No file of this folder imports `casid`; attitude,
integration and atmosphere are those of `problems.independent`. `problems/blind/strips.py` hands records and aircraft
file to the diagnosis. The campaign is

    python scripts/blind.py --sets strips --seeds 5001

The three aircraft are inventions of ordinary proportions and describe no real ones.
"""
