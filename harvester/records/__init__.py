"""Read measured files: columns with units and a time base.

A file is converted to evenly spaced samples in five steps:

    file ──> bytes, SHA-256      `formats.read_content`: regular files of limited size
         ──> Table               `formats.read_table`: the module of the file's format
         ──> MeasuredFile        `columns`: a heading gives each column's quantity and unit
         ──> values in SI        `columns`: the column of a quantity, its unit, scale and offset
         ──> even samples        `time_base`: rate or time stamps; `samples`: gaps, clipping

These modules read files this way: `excitation.recorded` (recorded base acceleration),
`identification.measurement` and `identification.measured_response` (records, frequency responses
and impedances), and `scene.force_file` (tables of force over displacement).
"""
