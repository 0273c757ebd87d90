"""A device as a sum of parts: spring, damper, contacts, transducer. All forces are defined here."""
