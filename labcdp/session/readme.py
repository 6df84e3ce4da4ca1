"""The page in a session's folder that describes its content."""

README = "README.txt"

README_TEXT = """\
A session recorded by labcdp
============================

This folder holds one measurement: a camera and a luminance meter looked at the same target, and everything
they said is here as they said it. Nothing in it is computed, so a result can be computed again from it.

session.toml    The configuration as it was used: camera, lens, meter with its serial number and calibration
                date, operator, target and plan. Lengths are in metres, times in seconds, luminance in cd/m2.

journal.jsonl   What was recorded, in order, one line of JSON each: line number, time, kind, content, and for
                a file its name, size and SHA-256. Frames are in DN (digital numbers). A reading has the unit
                the meter stated with it, its patch of the target, and the meter's reply as received.

frames/         The images, named number_role_exposure: 0001_light_5ms.tif is the first frame, taken of the
                target with an exposure of 5 ms; "dark" was taken with the lens covered. They are grey TIFF
                files of 8 or 16 bit that image programs open. A 12-bit image looks dark there, since white
                is 4095 of 65535; the values are right. The tag ImageDescription holds exposure, gain,
                temperature, time and camera as JSON.

journal.torn-*  Only there if the recording was cut off in the middle of a line: what was left of that line.

Please change nothing here. Every file has its checksum in the journal, and every line of the journal has one
of its own, so a change is noticed and the session no longer counts as sound.
Copy the folder as a whole. To read it in Python:

    from labcdp.session import Session

    session = Session.open("this folder")
    session.verify()                                # raises an error if something is missing or altered
    frame = session.load(session.frames()[0])       # frame.dn holds the pixels
    readings = [(r.patch, r.reading.luminance_cd_m2) for r in session.readings()]
"""
