"""Flight records: reading, checking and writing them. No dynamics here."""

from casid.records.column_map import ColumnMap, ColumnTerm, parse_map_option
from casid.records.readers import read_record, read_records, write_record
from casid.records.record import Record, require_channels
