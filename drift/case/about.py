"""Who makes a forecast and how it may be used, as only a person can say: attributes of ACDD-1.3 in
every file.
"""

from drift.case.values import fields


class AboutTable(fields.Table):
    """The [output] about table as written."""

    creator_name: fields.Label | None = None
    """Who made the forecast."""
    creator_email: fields.Label | None = None
    """Their address."""
    creator_url: fields.Label | None = None
    """Their page."""
    publisher_name: fields.Label | None = None
    """Who hands it out."""
    publisher_email: fields.Label | None = None
    """Their address."""
    publisher_url: fields.Label | None = None
    """Their page."""
    institution: fields.Label | None = None
    """Where it was made."""
    project: fields.Label | None = None
    """What it was made for."""
    license: fields.Label | None = None
    """How it may be used."""
    acknowledgement: fields.Label | None = None
    """Who is to be thanked."""
    naming_authority: fields.Label | None = None
    """Whose name `id` is, as a reversed domain."""
    processing_level: fields.Label | None = None
    """How far it was processed, in your words."""

    def told(self) -> dict[str, str]:
        """Return what is said, by the name of its attribute."""
        return {name: value for name, value in self if value is not None}
