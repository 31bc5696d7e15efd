# fembridge with CalculiX: docker build -t fembridge . && docker run --rm -v "$PWD:/data" fembridge simulate --stimulus noise_25_250 -o out
FROM python:3.13-slim-bookworm

# CalculiX, and the libraries that gmsh opens
RUN apt-get update \
    && apt-get install -y --no-install-recommends calculix-ccx libglu1-mesa libgl1 libxcursor1 libxft2 libxinerama1 libgomp1 \
    && rm -rf /var/lib/apt/lists/*

COPY pyproject.toml constraints.txt README.md LICENSE /source/
COPY decks /source/decks
COPY fembridge /source/fembridge
COPY neural /source/neural
RUN pip install --no-cache-dir -c /source/constraints.txt "/source[datasets,fast]" \
    && rm -rf /source \
    && useradd --create-home --uid 1000 fembridge \
    && mkdir /data && chown fembridge /data

USER fembridge
WORKDIR /data
ENTRYPOINT ["fembridge"]
CMD ["--help"]
