"""A device as a sum of parts: spring, damper, contacts, transducer. The only place of forces."""
