# harvester with ngspice: docs/how-to/install.md says how to build and run it.
FROM python:3.11-slim-bookworm

# The newest ngspice for the release, whichever that is: that of the backports takes compiled devices.
# hadolint ignore=DL3008
RUN echo "deb http://deb.debian.org/debian bookworm-backports main" \
        > /etc/apt/sources.list.d/backports.list \
    && apt-get update \
    && apt-get install --no-install-recommends --yes --target-release bookworm-backports \
        libngspice0 ngspice \
    && rm -rf /var/lib/apt/lists/*

COPY . /usr/src/harvester
RUN pip install --no-cache-dir "/usr/src/harvester[all]"

# Compiled code is kept here, whoever runs it.
ENV HOME=/tmp
WORKDIR /work
ENTRYPOINT ["harvester"]
