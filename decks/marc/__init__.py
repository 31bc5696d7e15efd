"""Marc: decks read and edited to the byte (`grammar`, `contents`), and written (`write`).

The dialect of Marc Mentat 2021.4. Written from real decks, never run in Marc.
"""
