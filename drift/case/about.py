"""The [output] about table: ACDD-1.3 attributes on authors and terms of use, in every output
file."""

from drift.case.values import fields


class AboutTable(fields.Table):
    """The [output] about table as written."""

    creator_name: fields.Label | None = None
    """Name of the person or group that made the forecast."""
    creator_email: fields.Label | None = None
    """Email address of the creator."""
    creator_url: fields.Label | None = None
    """Web page of the creator."""
    publisher_name: fields.Label | None = None
    """Name of the person or group that distributes the forecast."""
    publisher_email: fields.Label | None = None
    """Email address of the publisher."""
    publisher_url: fields.Label | None = None
    """Web page of the publisher."""
    institution: fields.Label | None = None
    """Institution where the forecast was made."""
    project: fields.Label | None = None
    """Project or purpose of the forecast."""
    license: fields.Label | None = None
    """Terms of use."""
    acknowledgement: fields.Label | None = None
    """Acknowledgements."""
    naming_authority: fields.Label | None = None
    """Organisation that assigned `id`, as a reversed domain."""
    processing_level: fields.Label | None = None
    """Level of processing, as free text."""

    def told(self) -> dict[str, str]:
        """Return the attributes that are given, by name."""
        return {name: value for name, value in self if value is not None}
