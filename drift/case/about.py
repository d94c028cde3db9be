"""Who makes a forecast and how it may be used, as only a person can say: attributes of ACDD-1.3 in every file."""

from drift.case import fields


class AboutTable(fields.Table):
    """The [output] about table as written."""

    creator_name: fields.Label | None = None
    creator_email: fields.Label | None = None
    creator_url: fields.Label | None = None
    publisher_name: fields.Label | None = None
    publisher_email: fields.Label | None = None
    publisher_url: fields.Label | None = None
    institution: fields.Label | None = None
    project: fields.Label | None = None
    license: fields.Label | None = None
    acknowledgement: fields.Label | None = None
    naming_authority: fields.Label | None = None
    processing_level: fields.Label | None = None

    def told(self) -> dict[str, str]:
        """Return what is said, by the name of its attribute."""
        return {name: value for name, value in self if value is not None}
