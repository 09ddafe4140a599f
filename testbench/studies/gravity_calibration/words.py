"""True arms in few words, for titles."""

TITLE_WORDS = {
    "tubes": "links of tubes",
    **{f"off_{percent}": f"links {percent} % off any tube" for percent in (10, 20, 40)},
    "cast": "cast links that no template holds",
    "joints": "links of tubes, joints unlike the folder's",
}
