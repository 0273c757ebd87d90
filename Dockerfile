# harvester with ngspice: docs/install.md says how to build and run it.
FROM python:3.11-slim-bookworm

# The newest ngspice of the release, whichever that is.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install --no-install-recommends --yes libngspice0 ngspice \
    && rm -rf /var/lib/apt/lists/*

COPY . /usr/src/harvester
RUN pip install --no-cache-dir "/usr/src/harvester[all]"

# Compiled code is kept here, whoever runs it.
ENV HOME=/tmp
WORKDIR /work
ENTRYPOINT ["harvester"]
